"""Before an experiment: what it will say of parameters and causes, and what a change would buy."""
