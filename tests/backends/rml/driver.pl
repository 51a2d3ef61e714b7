% Runs the published RML monitor on many specifications and traces, one process for each specification.
%
% swipl -p monitor=DIR driver.pl < jobs > verdicts
% A job is one line, {"spec": "FILE.pl", "traces": [[event, ...], ...]}; for each trace one line comes out: a letter for every
% prefix from the empty one on. T: the state may halt now or could before. F: no rule applied. E: an exception. ?: none of these.

:- use_module(library(http/json)).
:- use_module(library(unix)).
:- use_module(library(clpr)).
:- use_module(library(time)).
:- use_module(monitor(deep_subdict)).
:- use_module(monitor(trace_expressions_semantics)).
:- initialization(main, main).

main :-
    set_stream(user_input, encoding(utf8)),
    set_stream(user_output, encoding(utf8)),
    read_line_to_string(user_input, Line),
    jobs(Line).

jobs(end_of_file) :- !.
jobs(Line) :-
    flush_output(user_output),
    fork(Process),
    (   Process == child
    ->  catch((job(Line), Done = true), Error, (print_message(error, Error), Done = false)),
        exec(Done)  % `halt` may wait forever for the thread of library(time), which a forked process does not have
    ;   wait(Process, Status),
        (   Status == exited(0) -> true ; format("died ~w~n", [Status]) )
    ),
    read_line_to_string(user_input, Next),
    jobs(Next).

job(Line) :-
    open_string(Line, Stream),
    json_read_dict(Stream, Job),
    use_module(user:(Job.spec)),
    user:trace_expression(_, Start),
    forall(member(Trace, Job.traces), ( letters(Trace, Start, Letters), format("~s~n", [Letters]) )),
    flush_output(user_output).

letters(Trace, Start, [Letter|Letters]) :-
    halting(Start, Letter),
    follow(Trace, Start, Letter, Letters).

follow([], _, _, []).
follow([Event|Events], Term, Before, [Letter|Letters]) :-
    ( member(Before, `TFE`) -> Letter = Before, Next = Term
    ; catch(call_with_time_limit(20, next(Term, Event, Next)), _, fail_with(Letter)) -> ( var(Letter) -> halting(Next, Letter) ; true )
    ; [Letter] = `F`, Next = Term
    ),
    follow(Events, Next, Letter, Letters).

fail_with(Letter) :- [Letter] = `E`.

halting(Term, Letter) :-
    ( catch(may_halt(Term), _, fail_with(Letter)) -> ( var(Letter) -> [Letter] = `T` ; true ) ; [Letter] = `?` ).
