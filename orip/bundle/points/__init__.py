"""Ground points beside the corrections of an iteration: where they start, how they move, which ones are left out."""
