"""Every figure that surepath prints about itself, measured as ratios within one run."""
