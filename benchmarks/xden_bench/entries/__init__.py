"""What is kept of a score: entries, where they come from, ranks, the leaderboard."""
