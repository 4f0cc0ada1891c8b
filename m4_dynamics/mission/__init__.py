"""Missions: phases one after the other in one simulation, from four wheels to a climbed slope and back."""
