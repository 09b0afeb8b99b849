"""Places of contacts and cells in a picture: lines, triangles, boundary facets."""
