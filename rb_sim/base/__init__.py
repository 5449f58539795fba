"""What every package may use: errors, diagnostics, and what a failed start says."""

__version__ = "0.1.0"
