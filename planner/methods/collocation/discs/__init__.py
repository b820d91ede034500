"""Paths among discs: `thin_discs` keeps links from passing over discs, `legs` finds a way."""
