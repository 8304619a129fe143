"""Verification of plans before they are executed, and fail-safe braking."""
