"""A run looked at again: its files, what was driven, and what every planning cycle considered."""
