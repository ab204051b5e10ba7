"""Learners by value and by policy gradient on the staged decision process: the paper's, and two of today's."""
