"""The web app: a leaderboard, an object explorer, and a desk that takes submissions.

The desk (:mod:`~xden_bench.serve.desk`) is the back end and knows nothing of web pages.
"""
