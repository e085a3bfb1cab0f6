"""Map and landmark files: one importer per format."""
