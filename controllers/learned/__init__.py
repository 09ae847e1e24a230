"""Controllers that were learned elsewhere."""
