"""From a point cloud to its sparse surface."""
