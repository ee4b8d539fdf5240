"""From a submission and the truth to numbers with intervals."""
