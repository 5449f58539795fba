"""Damaged scene files and random scenes: none may end in anything but a result or one line."""
