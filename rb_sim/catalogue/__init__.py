"""What a scene can name: constraints, effects, contacts and curves, each with its equations."""
