"""What every package may use: errors, diagnostics, and what a failed start says."""
