"""The command ``videogrammetry``: one file a verb."""
