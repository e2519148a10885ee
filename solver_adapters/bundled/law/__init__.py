"""The crystal law at Gauss points, and its derivatives."""
