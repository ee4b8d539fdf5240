"""How well a dataset explains the captures it was made from."""
