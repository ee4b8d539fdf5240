"""The commands of ``xden-bench``, one module for each area. Heavy imports stay inside them."""
