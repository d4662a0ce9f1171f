"""A head from one photo, or from a few: the fitted model, what the photo shows besides, a field."""
