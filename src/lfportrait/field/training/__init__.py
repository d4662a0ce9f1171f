"""Training a field: rays, levels, exposures and cameras that are refined on the way."""
