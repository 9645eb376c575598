"""Images beside each other: levelled, registered, brought to one grid, and scored."""
