"""Formulas run by others: the package `ltlf2dfa` writes them as programs for MONA, and MONA makes an automaton.

Of ltlf2dfa only its parser and its translation are used. Its `to_dfa` writes every program to one file inside the installed
package, where two processes meet and where a read-only installation keeps an old program without a word, and it makes an
automaton even of the output of a missing MONA.
"""
