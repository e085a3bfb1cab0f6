"""The doors: HTTP, command line, pictures."""
