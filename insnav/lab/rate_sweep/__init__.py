"""Three gyros swept over rates about each axis."""
