% Runs a specification of RML in Prolog form on many traces, by the transition predicate of the published monitor.
%
% swipl -f none driver.pl -- MONITOR SPECIFICATION < TRACES
% MONITOR is the folder that holds trace_expressions_semantics.pl; a trace is one line, a JSON list of events. The first line that
% comes out says whether the specification could be loaded, then comes one for each trace: {"verdicts": ["unknown", "true", ...]},
% one verdict for each event, or {"error": "..."} where an exception was met. true: the state may halt, here or earlier.
% false: no transition, here or earlier.

:- use_module(library(apply)).
:- use_module(library(http/json)).
:- use_module(library(lists)).
:- use_module(library(readutil)).
:- dynamic complaint/1.
:- multifile user:message_hook/3.
:- initialization(main, main).

user:message_hook(_, error, Lines) :-
    with_output_to(string(Text), print_message_lines(current_output, '', Lines)),
    assertz(complaint(Text)).

main :-
    current_prolog_flag(argv, Arguments),
    append(_, [Monitor, Specification], Arguments),
    set_stream(user_input, encoding(utf8)),
    set_stream(user_output, encoding(utf8)),
    catch(loaded(Monitor, Specification), Error, complain(Error)),
    (   complaint(Text)
    ->  answer(_{error: Text})
    ;   answer(_{loaded: true}),
        read_line_to_string(user_input, Line),
        traces(Line)
    ).

loaded(Monitor, Specification) :-
    asserta(user:file_search_path(monitor, Monitor)),
    use_module(user:monitor(trace_expressions_semantics)),
    use_module(user:Specification),
    once(user:trace_expression(_, _)).
loaded(_, _) :-
    complaint(_), !.
loaded(_, _) :-
    assertz(complaint("it has no trace_expression/2")).

complain(Error) :-
    in_short(Error, Text),
    assertz(complaint(Text)).

traces(end_of_file) :- !.
traces(Line) :-
    (   catch(judged(Line, Verdicts), Error, true)
    ->  (   var(Error) -> answer(_{verdicts: Verdicts}) ; in_short(Error, Text), answer(_{error: Text}) )
    ;   answer(_{error: "the driver failed"})
    ),
    read_line_to_string(user_input, Next),
    traces(Next).

% A copy, so that nothing that was bound on the way stays.
judged(Line, Verdicts) :-
    findall(Found, once(followed(Line, Found)), [Verdicts]).

followed(Line, Verdicts) :-
    open_string(Line, Stream),
    json_read_dict(Stream, Events),
    user:trace_expression(_, Term), !,
    (   user:may_halt(Term)
    ->  all(Events, "true", Verdicts)
    ;   follow(Events, Term, Verdicts)
    ).

follow([], _, []).
follow([Event|Events], Term, [Verdict|Verdicts]) :-
    (   user:next(Term, Event, After)
    ->  (   user:may_halt(After) -> Verdict = "true" ; Verdict = "unknown" )
    ;   Verdict = "false"
    ),
    (   Verdict == "unknown" -> follow(Events, After, Verdicts) ; all(Events, Verdict, Verdicts) ).

all(Events, Verdict, Verdicts) :-
    same_length(Events, Verdicts),
    maplist(=(Verdict), Verdicts).

answer(Answer) :-
    json_write_dict(user_output, Answer, [width(0)]),
    nl(user_output),
    flush_output(user_output).

% Terms can be large, and even infinite.
in_short(Error, Text) :-
    (   nonvar(Error), Error = error(Formal, _) -> true ; Formal = Error ),
    with_output_to(string(Text), write_term(Formal, [quoted(true), max_depth(8)])).
