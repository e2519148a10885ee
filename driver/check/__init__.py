"""The verb `check`: what is wrong or doubtful in a case, before anything runs."""
