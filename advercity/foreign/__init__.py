"""Files that others wrote: XML with places, and a record of what is not taken over from them."""
