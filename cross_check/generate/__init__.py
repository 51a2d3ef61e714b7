"""Random trees and traces; traces may be led through a tree.

They detect it, nearly detect it, or did before something disturbed them.
"""
