"""Results for programs: result.json, written and read, and residuals.csv."""
