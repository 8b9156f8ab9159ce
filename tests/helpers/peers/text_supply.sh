#!/bin/sh
# A power supply that speaks SCPI, for socat: sh text_supply.sh FOLDER. The folder keeps its state from one connection
# to the next, and `log` there has a line for each line that it got.
#
#   *IDN?    SYST:ERR?    OUTP ON|OFF    OUTP?    CHn:VOLT x (0 to 60)    CHn:VOLT?    CHn:MEAS? (0 while the output is off)
#   OVER? (overflow)    NAN?    TWICE? (answers two lines)    HANG? (does not answer)
# Several in one line are joined by ";", and so are their answers.
cd "$1" || exit 1

kept() { # NAME DEFAULT: into $value
    value=$2
    [ -r "$1" ] && read -r value <"$1"
}

keep() { # NAME VALUE: at once, as another connection may read it
    printf '%s\n' "$2" >"$1.$$" && mv "$1.$$" "$1"
}

refuse() {
    printf '%s\n' "$1" >>errors
}

next_error() {
    if [ -s errors ]; then
        read -r first <errors
        sed -i 1d errors
        answer="$first"
    else
        answer='0,"No error"'
    fi
}

set_voltage() { # NAME NUMBER
    case $2 in
    *[!0-9.]* | *.*.* | '' | .) refuse '-104,"Data type error"' ;;
    *) if [ "${2%%.*}" -ge 60 ]; then refuse '-222,"Data out of range"'; else keep "$1" "$2"; fi ;;
    esac
}

obey() { # one command; its answer into $answer
    answer=
    case $1 in
    '*IDN?') answer='SOCAT,SUPPLY-1,0,1.0' ;;
    'SYST:ERR?') next_error ;;
    'OUTP ON') keep output 1 ;;
    'OUTP OFF') keep output 0 ;;
    'OUTP?') kept output 0; answer=$value ;;
    'OVER?') answer=9.9E37 ;;
    'NAN?') answer=9.91E37 ;;
    'TWICE?') answer='1
2' ;;
    'HANG?') ;;
    CH*:VOLT\?) kept "${1%:VOLT?}" 0; answer=$value ;;
    CH*:MEAS\?)
        kept output 0
        if [ "$value" = 1 ]; then kept "${1%:MEAS?}" 0; fi
        answer=$(printf '%+.5E' "$value") ;;
    CH*:VOLT\ *) set_voltage "${1%%:*}" "${1#* }" ;;
    *) refuse '-113,"Undefined header"' ;;
    esac
}

while IFS= read -r line; do
    printf '%s\n' "$line" >>log
    answers=
    while :; do
        command=${line%%;*}
        obey "${command#:}"
        if [ -n "$answer" ]; then answers="$answers${answers:+;}$answer"; fi
        case $line in *\;*) line=${line#*;} ;; *) break ;; esac
    done
    if [ -n "$answers" ]; then printf '%s\n' "$answers"; fi
done
