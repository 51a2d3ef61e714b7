"""Random trees and traces: detecting, near misses, and disturbed ones."""
