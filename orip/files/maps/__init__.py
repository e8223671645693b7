"""Drawings for GIS and CAD: GeoPackage, GeoJSON and DXF, from layers of points, lines and areas."""
