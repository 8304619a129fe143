"""Deterministic generator of the small CommonRoad scenarios in this folder."""
