"""What each kind of store holds: its tables, and its records as rows and back."""
