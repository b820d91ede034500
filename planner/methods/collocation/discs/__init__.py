"""Paths among discs: `thin_discs` keeps links from passing over one, `legs` finds a way around."""
