"""Control programs at random: is what umo makes of them in C equal to Python, or refused before anything runs?"""
