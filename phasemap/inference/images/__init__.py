"""From a stack of images to materials: data, model, search and verdict."""
