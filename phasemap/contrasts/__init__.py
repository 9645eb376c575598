"""Phase contrast between two materials: its map, where it jumps and turns round, and where to work."""
