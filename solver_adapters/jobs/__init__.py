"""Programs of their own as jobs: a folder, a supervised run, a status."""
