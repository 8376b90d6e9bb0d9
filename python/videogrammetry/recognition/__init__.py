"""Recognition: pictures to targets."""
