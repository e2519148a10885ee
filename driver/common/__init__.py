"""What all rooms use: errors, progress, parallel runs, formatted numbers, splines."""
