"""Motions among discs: `thin_discs` thickens thin discs, `legs` finds a motion leg by leg."""
