"""What a motion must keep."""
