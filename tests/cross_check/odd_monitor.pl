% A monitor of a few lines that does what the published one should not.
:- module(trace_expressions, [next/3, may_halt/1]).
next(Term, Event, After) :- get_dict(event, Event, Name), step(Name, Term, After).
step("a", Term, Term).
step("halt", _, done).
step("fail", _, _) :- fail.
step("raise", _, _) :- throw(error(type_error(evaluable, f(X, X)), a_long_story)).
step("throw", _, _) :- throw(left).
step("endless", _, Term) :- Term = f(Term), throw(Term).
step("loop", Term, After) :- step("loop", Term, After).
step("deep", Term, f(After)) :- step("deep", Term, After).
may_halt(done).
