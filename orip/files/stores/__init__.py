"""Record stores: one SQLite file each for cameras, temticks, photos, templates, bundles and photo observations."""
