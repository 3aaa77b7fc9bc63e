"""Foreign files: XML with places, and a record of their omitted parts."""
