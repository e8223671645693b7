"""What an adjusted block gives: values, precision, covariances and reliability in the user's names and units."""
