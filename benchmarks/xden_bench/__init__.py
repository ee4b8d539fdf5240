"""Scores submissions and keeps the leaderboard."""
