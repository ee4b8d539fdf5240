"""Predictors to beat."""
