"""The loop over photo points in C and its binding: normal equations without a stored design matrix."""
