"""`python -m bench --fleet`: many stations on many computers, what they cost, and what is lost when parts of it die."""
