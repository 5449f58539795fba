"""The methods: one file each, with its settings and its step."""
