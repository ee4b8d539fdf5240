"""Which objects of a rebuild a person must look at, why, and what to do about it."""
