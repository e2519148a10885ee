"""Whether what is told of the parameters, a Gaussian, is the posterior."""
