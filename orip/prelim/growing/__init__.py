"""Growing a block photo by photo: the block as it grows, photos in the wrong place, and why a photo was not oriented."""
