"""How well a pose can be known: sensors, triplets, covariances, uncertainty fields."""
