"""What happens to contacts at an instant: impacts, and which of them open, slip, stick or roll."""
