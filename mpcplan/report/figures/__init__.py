"""Figures of the report, as plotly.js draws them."""
