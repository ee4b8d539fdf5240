"""Our ways against others, as ratios in one run; growth of time and memory."""
