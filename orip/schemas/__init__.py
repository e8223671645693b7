"""JSON Schemas of the documents that orip writes for programs: their types, and the schema files made of them."""
