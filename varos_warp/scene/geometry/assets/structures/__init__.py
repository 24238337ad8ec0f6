"""Structures of several pieces, each with a name and a colour: hull section, mooring chain, quay wall, ROV panel."""
