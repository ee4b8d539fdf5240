"""What a dataset folder says of itself: card, Croissant, datasheet."""
