"""Maps of where a robot can climb, and what stops it elsewhere."""
