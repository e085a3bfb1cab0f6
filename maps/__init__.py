"""Where things are: grids, floors, landmarks, lines of sight. No probability."""
