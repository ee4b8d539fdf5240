"""What training a network takes, whatever it learns: a clock, held-out objects, checkpoints."""
