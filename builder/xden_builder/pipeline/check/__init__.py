"""What a capture folder can be told before anything is fitted."""
