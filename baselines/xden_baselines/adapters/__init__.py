"""Output files of the original methods' own runs, made into submissions."""
