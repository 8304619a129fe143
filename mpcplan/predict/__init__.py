"""Prediction of the others, and its projection onto a road."""
