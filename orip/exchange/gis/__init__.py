"""Results for GIS and CAD: tables, GeoPackage, DXF. Coordinates are those of the project."""
