"""What a radiograph of known densities looks like."""
