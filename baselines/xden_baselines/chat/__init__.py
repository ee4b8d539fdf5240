"""Chat models behind recorded answers, and what is asked of them: materials."""
