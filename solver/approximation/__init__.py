"""From a mesh to its sparse surface."""
