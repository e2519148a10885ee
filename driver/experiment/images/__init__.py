"""Height maps: files, calibration, flat field, noise, outliers and rigid motion."""
