"""One capture into one density object."""
