"""X-Field: density and parts at any point inside, from two radiographs and the outer surface."""
