"""One HTML page that shows a motion: its data, and the JavaScript that draws it."""
