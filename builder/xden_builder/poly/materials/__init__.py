"""What a part may be made of, how dense that is, and how probable the images make it."""
