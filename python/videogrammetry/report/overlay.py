"""A picture with the targets found in it."""
