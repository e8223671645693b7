"""Commands that list and edit the records of the stores: cameras, tick marks, photos, templates, bundles, models."""
