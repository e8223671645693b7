"""What the owner of a project defines in orip.toml: cameras, photos, templates, models and bundles.

Each record is declared once with its fields, from which store columns, keys and headings follow.
"""
