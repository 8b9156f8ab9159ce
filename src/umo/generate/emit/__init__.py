"""From the form to text of C, and the files around it: only here C is written."""
