"""Growing a block photo by photo: the block as it grows, misplaced photos, and why a photo was not oriented."""
