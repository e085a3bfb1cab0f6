"""Which way to go: grid search, sampling (OMPL), smoothing (CasADi)."""
