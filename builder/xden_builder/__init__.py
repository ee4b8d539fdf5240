"""Reconstructs density from a scanner's captures and writes the dataset."""
