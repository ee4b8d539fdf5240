"""The function that is minimised: samples, how far each is trusted, priors."""
