"""What files of pictures hold besides their pixels, and which files those are."""
