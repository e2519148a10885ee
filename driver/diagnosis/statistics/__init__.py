"""Statistics of the diagnosis: score test, Bayes factor, goodness of fit."""
