"""Projects of other programs: imported as a project folder, results written back."""
