"""Sites drawn for this project: data files only."""
