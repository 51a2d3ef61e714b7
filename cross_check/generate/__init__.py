"""Random trees and traces; traces may be led through a tree: they detect it, nearly detect it, or did before something disturbed them."""
