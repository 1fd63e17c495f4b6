"""Surprise on the human test of ADEPT: is what cannot be more surprising than what can?"""
